"""What will be computed: blocks of runs, and the digest of all that each depends on."""
