"""Methods: one module each, which declares `METHOD`, a record of `hhsim.solver.method.Method`."""
