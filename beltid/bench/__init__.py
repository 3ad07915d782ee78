"""Recordings of the benches: files of any format in, validated columns out.

Data flows one way: `files` names the files of a recording, a reader of their format (`cells`,
`formats`) yields tables as written (`raw.Raw`), `mapping` finds our columns in them, `runs` makes
runs of them and checks them. `recording` is the way from a path to columns, and tells of its steps.
"""
