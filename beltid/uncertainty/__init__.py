"""How far a result can be off: contributions, shared errors, and the Monte Carlo check."""
