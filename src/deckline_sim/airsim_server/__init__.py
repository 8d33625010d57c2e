"""Serves the simulator to AirSim's clients."""
