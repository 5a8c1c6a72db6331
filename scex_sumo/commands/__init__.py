"""What all commands share: options, configuration files, JSON, tables, the console."""
