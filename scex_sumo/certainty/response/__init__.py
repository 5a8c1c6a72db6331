"""Critical response: what the other vehicle does and how late one responds until two vehicles collide."""
