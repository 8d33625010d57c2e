"""Landings by the thousand, and the models of sight that they need."""
