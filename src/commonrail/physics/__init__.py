"""Model of an injector: fuel, flow laws, components, the equations dy/dt = f(t, y) and the fast step."""
