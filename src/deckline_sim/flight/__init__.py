"""Where ship and aircraft are: deck motion, approaches, the paper's profile, unrelated views."""
