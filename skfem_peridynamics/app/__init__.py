"""The command: scenes in TOML, runs into a folder, tables and pictures."""
