"""Reduce recordings of the friction rig to one friction coefficient per run, Eqs. (5) to (8).

`run` derives the tensions and splits a recording, `prepare` processes each run alone, (S1),
`bench_model` all runs together, (S2), and the zeros and gains of the cells, (S3) and (S4);
`reduction` leads through both passes and sets plateau, peak and status.
"""
