"""PLY and PCD read by the rules of their formats alone, every value within its type."""

import numpy as np

__all__ = ["read_pcd", "read_ply"]

_PLY_TYPES = {"float": np.float32, "double": np.float64, "uchar": np.uint8, "ushort": np.uint16,
              "int": np.int32}


def _column(words, kind):
    """Words of a file as numbers of a type, all of which it can hold, and finite."""
    kind = np.dtype(kind)
    numbers = [float(word) if kind.kind == "f" else int(word) for word in words]
    array = np.array(numbers, kind)
    assert np.isfinite(array).all()
    assert kind.kind == "f" or array.tolist() == numbers
    return array


def read_ply(octets):
    """Columns of an ASCII PLY's vertices by their names, in order, and its faces (m, 3)."""
    lines = octets.decode("ascii").split("\n")
    assert lines.pop() == "" and lines[:2] == ["ply", "format ascii 1.0"]
    elements, at = {}, 2
    while lines[at] != "end_header":
        word, *rest = lines[at].split(" ")
        if word == "element":
            properties = elements[rest[0]] = (int(rest[1]), {})
        elif word == "property":
            properties[1][rest[-1]] = rest[:-1]
        else:
            assert word == "comment"
        at += 1
    found, at = {}, at + 1
    for name, (count, properties) in elements.items():
        table = [line.split(" ") for line in lines[at:at + count]]
        assert len(table) == count
        found[name] = table, properties
        at += count
    assert at == len(lines)
    table, properties = found["vertex"]
    assert all(len(row) == len(properties) for row in table)
    columns = {name: _column([row[at] for row in table], _PLY_TYPES[kind[0]])
               for at, (name, kind) in enumerate(properties.items())}
    faces, kinds = found.get("face", ([], {"vertex_indices": ["list", "uchar", "int"]}))
    assert kinds == {"vertex_indices": ["list", "uchar", "int"]}
    assert all(row[0] == "3" and len(row) == 4 for row in faces)
    faces = np.array([row[1:] for row in faces], np.int32).reshape(-1, 3)
    assert not faces.size or faces.min() >= 0 and faces.max() < len(table)
    return columns, faces


def read_pcd(octets):
    """Columns of an ASCII PCD by their names, in order; ``rgb`` is three of them."""
    lines = [line for line in octets.decode("ascii").split("\n") if not line.startswith("#")]
    assert lines.pop() == ""
    head = dict(line.split(" ", 1) for line in lines[:10])
    assert list(head) == ["VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT",
                          "VIEWPOINT", "POINTS", "DATA"]
    assert head["DATA"] == "ascii" and head["HEIGHT"] == "1" and head["POINTS"] == head["WIDTH"]
    names, sizes, types = (head[name].split() for name in ("FIELDS", "SIZE", "TYPE"))
    table = [line.split(" ") for line in lines[10:]]
    assert len(table) == int(head["POINTS"]) and set(head["COUNT"].split()) == {"1"}
    assert all(len(row) == len(names) == len(sizes) == len(types) for row in table)
    columns = {}
    for at, (name, size, kind) in enumerate(zip(names, sizes, types, strict=True)):
        values = _column([row[at] for row in table],
                         f"{ {'F': 'f', 'U': 'u', 'I': 'i'}[kind] }{size}")
        if name == "rgb":
            columns |= {colour: (values >> shift & 255).astype(np.uint8)
                        for colour, shift in (("red", 16), ("green", 8), ("blue", 0))}
        else:
            columns[name.replace("normal_", "n")] = values
    return columns
