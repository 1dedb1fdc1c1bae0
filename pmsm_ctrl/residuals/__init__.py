"""What a residual depends on."""
