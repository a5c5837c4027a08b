"""Plan of blocks, their keys, and the processes that compute them."""
