"""What only a flow can tell, and what it is compared with."""
