"""Batches of plants."""
