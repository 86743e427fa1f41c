"""Why statements of the papers do not hold on simulated lanes: experiments, a module for each paper."""
