"""What a run writes and reads: whole or not at all."""
