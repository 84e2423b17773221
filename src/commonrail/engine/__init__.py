"""How an injector is simulated: operating points, lanes, reference engines, stepper, solutions, status."""
