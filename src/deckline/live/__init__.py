"""Guidance from a camera while it flies: capture, perceive and guide, each in a thread of its own."""
