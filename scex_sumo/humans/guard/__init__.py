"""Guard: it keeps a model's planned way and lowers the speed to a safe one."""
