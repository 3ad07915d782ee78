"""The figures of the report, a module per topic; numbers in brackets are the paper's figures."""
