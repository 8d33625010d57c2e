"""Runways on land as photographs show them: paint by the standard, any ground, drawn in a few milliseconds."""
