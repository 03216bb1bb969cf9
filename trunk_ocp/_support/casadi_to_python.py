"""CasADi functions of scalar operations as Python source, for numba and for exported modules."""

from __future__ import annotations

import casadi as ca

from ..errors import TrunkError

_ARITHMETIC = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_ASSIGN: "{0}",
}
_FUNCTIONS = {
    ca.OP_COS: "xp.cos({0})",
    ca.OP_SIN: "xp.sin({0})",
    ca.OP_SQRT: "xp.sqrt({0})",
    ca.OP_LT: "{0} < {1}",
    ca.OP_NOT: "xp.logical_not({0})",
    ca.OP_IF_ELSE_ZERO: "xp.where({0}, {1}, 0.0)",
}


def python_source(function: ca.Function, name: str, namespace: bool = False) -> str:
    """Python source of a CasADi SX function: name(input 0, ..., output 0, ...).

    Inputs are read and outputs set entry by entry, column by column; entries may be numbers or
    arrays. With `namespace` there is a last argument `xp`, an array library such as numpy, whose
    functions are called; without it, only arithmetic is translated.

    Raises
    ------
    TrunkError
        If the function is not an SX function, or uses an untranslated operation.
    """
    if not function.is_a("SXFunction"):
        raise TrunkError(f"{function.name()}: expected an SX function.")
    operations = _ARITHMETIC | (_FUNCTIONS if namespace else {})
    arguments = [f"i{k}" for k in range(function.n_in())]
    arguments += [f"o{k}" for k in range(function.n_out())]
    arguments += ["xp"] if namespace else []
    lines = [f"def {name}({', '.join(arguments)}):"]
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        to, source = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_CONST:
            lines.append(f"    w{to[0]} = {function.instruction_constant(k)!r}")
        elif operation == ca.OP_INPUT:
            lines.append(f"    w{to[0]} = i{source[0]}[{source[1]}]")
        elif operation == ca.OP_OUTPUT:
            lines.append(f"    o{to[0]}[{to[1]}] = w{source[0]}")
        elif operation in operations:
            expression = operations[operation].format(*(f"w{s}" for s in source))
            lines.append(f"    w{to[0]} = {expression}")
        else:
            raise TrunkError(f"{function.name()}: operation {operation} is not translated.")
    if len(lines) == 1:
        lines.append("    pass")  # all outputs are zero
    return "\n".join(lines)
