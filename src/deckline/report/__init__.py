"""What a run writes for people: records, pictures, film, report."""
