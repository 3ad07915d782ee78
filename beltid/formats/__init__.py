"""Bench formats: the bytes of a recording to its channels, before anybody knows what they mean."""
