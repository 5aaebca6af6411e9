"""Constants of fabrics: from tables, published data or instruments, and per region of a cloth."""
