"""Code from elsewhere: how its errors are reported and interrupts are kept from it."""
