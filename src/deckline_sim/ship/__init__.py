"""Everything of a ship and what lies around it: classes, outline, paint, solids, lamps."""
