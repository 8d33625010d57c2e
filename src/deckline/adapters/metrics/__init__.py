"""Figures of a live flight for monitoring."""
