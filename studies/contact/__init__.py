"""Does a cloth on an obstacle give the known answers, and at which order?"""
