"""What is proposed at a cell: boxes, solutions, weights. None of it is trusted: `ccpin.proof` checks it."""
