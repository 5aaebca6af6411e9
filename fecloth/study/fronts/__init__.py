"""The front of a problem: what each accuracy costs, and which setting is the cheapest."""
