"""beltid."""
