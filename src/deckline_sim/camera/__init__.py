"""From a scene's light to what is recorded: air, exposure, lens, sensor, depth camera, navigation unit."""
