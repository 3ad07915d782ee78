"""What must stay: the program at its doors, as it was before it was written again."""
