"""The pose of the aircraft relative to the runway from the picture alone: one frame, and over frames."""
