"""An autopilot over MAVLink: guidance out, poses in."""
