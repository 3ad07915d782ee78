"""One file per subcommand: read, science, write. Stages do not import each other."""
