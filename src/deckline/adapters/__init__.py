"""Adapters: each only translates between deckline's own types and another system's."""
