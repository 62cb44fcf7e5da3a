"""Virtual patients with spasticity: from latent mechanisms to clinical tests, grades and a dataset."""
