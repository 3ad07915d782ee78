"""The commands: parse, call a stage, print, exit. No science, no files."""
