"""Trains the networks, measures the chain against truth, and prints the tables of the paper."""
