"""Does bending converge, with which model, on which mesh?"""
