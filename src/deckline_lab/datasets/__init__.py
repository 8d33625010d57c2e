"""The paper's dataset of clear and hazy pairs."""
