"""What functions take of parameters that a typing.Protocol describes; files are read, not run.

A value of a protocol is followed through assignments, through the fields of its class, and
through members that have a protocol themselves.  It may go no way on which it would be lost.
"""

import ast
from functools import cached_property
from itertools import chain


def parameters(function):
    """The ast.arg of each, without `self`."""
    own = function.args
    return [one for one in (*own.posonlyargs, *own.args, *own.kwonlyargs) if one.arg != "self"]


def names_in(*nodes):
    """The names in expressions, None among them."""
    found = chain(*(ast.walk(node) for node in nodes if node is not None))
    return [one.id for one in found if isinstance(one, ast.Name)]


def functions(tree):
    """(its class or None, function) of those in a module and in its classes."""
    for node in tree.body:
        for one in node.body if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(one, ast.FunctionDef):
                yield (None if one is node else node), one


def pairs(function):
    """(target, value) of all its assignments, in tuples one by one."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assign | ast.AnnAssign | ast.NamedExpr):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                yield from zip(target.elts, node.value.elts, strict=False)
            else:
                yield target, node.value


class Rooms:
    """Modules {path: ast.Module} that see each other by protocols."""

    def __init__(self, trees):
        self.trees = trees
        classes = [n for t in trees.values() for n in t.body if isinstance(n, ast.ClassDef)]
        self.protocols = {c.name: c for c in classes if "Protocol" in names_in(*c.bases)}
        self.parts = set()  # the classes that take a protocol
        self._callees = {}  # the protocols of the parameters of functions and classes, by name
        for owner, one in chain(*map(functions, trees.values())):
            kinds = [self._kind(p.annotation) for p in parameters(one)]
            if owner is None or one.name == "__init__":
                self._callees[(owner or one).name] = kinds
            if owner is not None and any(kinds):
                self.parts.add(owner.name)

    def _kind(self, annotation):
        return next((one for one in names_in(annotation) if one in self.protocols), None)

    def own(self, name):
        """{member: (the protocol that it is, or None, names in its annotation)}, without bases'."""
        body = self.protocols[name].body
        fields = (one for one in body if isinstance(one, ast.AnnAssign))
        found = {f.target.id: (self._kind(f.annotation), names_in(f.annotation)) for f in fields}
        return found | {one.name: (None, []) for one in body if isinstance(one, ast.FunctionDef)}

    def line(self, name):
        """A protocol and those that it extends."""
        bases = (one for one in names_in(*self.protocols[name].bases) if one in self.protocols)
        return [name, *chain(*map(self.line, bases))]

    def member(self, name, attribute):
        """(the protocol that declares it, what it is), or None."""
        found = ((one, self.own(one)) for one in self.line(name))
        return next(((one, own[attribute][0]) for one, own in found if attribute in own), None)

    @cached_property
    def _read(self):
        """Which members are taken, and the faults."""
        taken, faults = set(), []
        for path, tree in self.trees.items():
            fields = {}  # of each class
            for last in (False, True):  # first to know all fields
                for owner, one in functions(tree):
                    reader = Reader(self, one, fields.setdefault(owner and owner.name, {}))
                    taken |= reader.taken
                    faults += [f"{path}, {fault}" for fault in reader.faults if last]
        return taken, faults

    @property
    def faults(self):
        """Sentences about what is taken outside of a protocol, or is lost sight of."""
        return self._read[1]

    @property
    def idle(self):
        """Members that nobody takes."""
        members = {(name, one) for name in self.protocols for one in self.own(name)}
        return sorted(members - self._read[0])

    @property
    def wide(self):
        """Members that are a whole part, which others should see by a protocol."""
        return [
            (name, one)
            for name in self.protocols
            for one, (_, names) in self.own(name).items()
            if self.parts & {*names}
        ]

    def wanted(self, call, argument):
        """The protocol of the parameter that gets an argument of a call, or None."""
        kinds, index = self._callees.get(ast.unparse(call.func), []), call.args.index(argument)
        return kinds[index] if index < len(kinds) else None


class Reader:
    """One function, and the fields of its class that hold a value of a protocol."""

    def __init__(self, rooms, function, fields):
        self.rooms, self.fields = rooms, fields
        self.taken, self.faults = set(), []
        kinds = ((p.arg, rooms._kind(p.annotation)) for p in parameters(function))
        self.names = {name: kind for name, kind in kinds if kind}
        assigned = list(pairs(function))
        for target, value in [*assigned, *assigned]:
            if (kind := self.kind(value)) and isinstance(target, ast.Name):
                self.names[target.id] = kind
            elif kind and ast.unparse(target).startswith("self._"):
                fields[target.attr] = kind
        kept = {value for target, value in assigned if self.kind(target)}
        for parent in ast.walk(function):
            for node in ast.iter_child_nodes(parent):
                place = f"line {getattr(node, 'lineno', 0)}: {ast.unparse(node)}"
                if isinstance(node, ast.Attribute):
                    self.look(node, place)
                loads = isinstance(getattr(node, "ctx", None), ast.Load) and node not in kept
                if loads and self.kind(node) and not self.is_seen(node, parent):
                    self.faults.append(f"{place} is lost sight of")

    def kind(self, node):
        """The protocol of an expression, or None."""
        if isinstance(node, ast.Name):
            return self.names.get(node.id)
        if not isinstance(node, ast.Attribute):
            return None
        if ast.unparse(node.value) == "self":
            return self.fields.get(node.attr)
        owner = self.kind(node.value)
        return (self.rooms.member(owner, node.attr) or (None, None))[1] if owner else None

    def look(self, node, place):
        if owner := self.kind(node.value):
            member = self.rooms.member(owner, node.attr)
            if member is None:
                self.faults.append(f"{place} is not in {owner}")
            else:
                self.taken.add((member[0], node.attr))

    def is_seen(self, node, parent):
        """Whether nothing can be taken of a value unseen, by what is done with it."""
        if isinstance(parent, ast.Call) and node in parent.args:
            wanted, given = self.rooms.wanted(parent, node), self.kind(node)
            needs = chain(*map(self.rooms.own, self.rooms.line(wanted))) if wanted else ()
            return bool(wanted) and all(self.rooms.member(given, one) for one in needs)
        return isinstance(parent, ast.Attribute | ast.Compare)
