"""The numerical experiment."""
