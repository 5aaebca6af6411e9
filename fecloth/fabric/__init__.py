"""Constants of fabrics: given, published or from instruments, and by region of a cloth."""
