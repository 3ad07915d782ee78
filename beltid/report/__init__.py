"""Turn results into charts, pages and terminal tables; no science."""
