"""Speed of the imaging operator beside other codes and the machine's own limits."""
