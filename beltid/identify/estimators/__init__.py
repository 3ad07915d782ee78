"""Statistics that every identification needs, each once."""
