"""What makes a site of the pages, the code and the results: `make docs`."""
