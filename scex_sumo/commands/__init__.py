"""What the commands of the command line do, one module each; imported only when the command is called."""
