"""Find the files of a recording and detect their formats, before any channel is read.

============ ===================================================================
Module       Responsibility
============ ===================================================================
``sources``  list the files: one, or one per run in a folder or zip file
``archives`` unpack gzip and zip files
``sniff``    detect the format from the bytes; decode text files
``ahead``    produce items in a separate thread
============ ===================================================================
"""
