"""Recordings of the benches: files of any format in, validated columns out.

Data flows one way: `files` names the files of a recording, a reader of their format (`cells`,
`formats`) yields tables as written (`raw.Raw`), `mapping` finds our columns in them, `columns` and
`runs` make runs of them and check them. `recording` is the way from a path to columns, and tells of
its steps.
"""
