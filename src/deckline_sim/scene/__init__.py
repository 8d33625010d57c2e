"""Weather, light and the renderer that draws a ship, sea, sky and ground."""
