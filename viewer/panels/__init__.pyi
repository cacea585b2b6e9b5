from .window import Panels as Panels
