"""The mapping that tests of imports share: scans by tones in the array ``s``, by one antenna."""

TIME = '[time]\nvariable = "t"\nunit = "s"\n'
"""The radar's time of every scan, in the array ``t``."""


def line_mapping(file=None, *tables, tones="span = [1.0, 1.2]", polarization="HH", height=0.0):
    """Return the text of a mapping of ``s`` (scan, frequency) and of further tables, with the name of its file if any.

    ``tones`` are the entry of the frequencies, GHz; the antenna stands ``height`` m over the vehicle's origin.
    """
    lines = ['title = "made up"', f'polarization = ["{polarization}"]']
    if file is not None:
        lines.append(f'files.data = "{file}"')
    lines += [
        "[signal]",
        'variable = "s"',
        'dims = ["scan", "frequency"]',
        "[frequency]",
        tones,
        'unit = "GHz"',
        "[antenna_position]",
        f"values = [[0, 0, {height}]]",
        'unit = "m"',
    ]
    return "\n".join(lines) + "\n" + "".join(tables)
