"""Measures the chain and its parts against truth."""
