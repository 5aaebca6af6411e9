"""`fit`: constants from measurements, and what the measurements do not tell."""
