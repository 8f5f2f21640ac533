"""Measured frequency responses in a spec: their section, their files, and what specs with them cannot ask for."""
