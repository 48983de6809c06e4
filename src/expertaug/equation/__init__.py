"""From a learned term to an equation: candidate terms, their selection, and the refit through the solver."""
