"""Landings in a closed loop: flight dynamics, moving deck, air, navigation, camera, deckline's guidance, autopilot."""
