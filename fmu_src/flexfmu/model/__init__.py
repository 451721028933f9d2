"""What a reduced body is: its data, and the modal file that holds them."""
