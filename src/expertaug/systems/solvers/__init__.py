"""Solving dy/dt = f(t, y), one method or family a module; :class:`~expertaug.Solver` chooses among them."""
