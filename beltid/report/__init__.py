"""Turn results into charts, pages and terminal tables; no science.

`summary` words names and values and is what a command shows, `view` what people see of an
artifact; `results` are those of a belt, the input of `charts` (registry and look), `figures` (the
charts themselves), `verdict` and `page`.
"""
