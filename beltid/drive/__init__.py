"""A belt drive predicted from the identified law."""
