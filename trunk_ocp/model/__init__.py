"""What a trunk is: anatomy, muscles, head and loads (sections 2.1, 3 and 4)."""
