"""The files of a recording, before anything is known about what they hold.

============ ===================================================================
Module       Responsibility
============ ===================================================================
``sources``  the files: one, or one per run in a folder or zip file
``archives`` files packed with gzip or zip
``sniff``    which format the bytes are, by content; the text of a text file
``ahead``    items made by a thread of their own
============ ===================================================================
"""
