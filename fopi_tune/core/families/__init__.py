"""Families that are made of several: lists of plants."""
