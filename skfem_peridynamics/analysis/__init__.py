"""What a run means: energies of the theorems, damage."""
