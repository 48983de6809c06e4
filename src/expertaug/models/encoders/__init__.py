"""Encoders: from the observed window to a posterior over (z_e, z_a).

An encoder is a module with ``latent`` (size of z_a), ``head_prefix`` (parameters of the z_e head alone) and
``forward(observed) → Posterior``, observed being (T1, …, B, *state).  ``fit`` sees the training set's observed window
once, before training.
"""
