"""The commands: parse arguments, call a stage, print, exit. No science, no file access."""
