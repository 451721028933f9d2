"""Pictures of a body: what moves, by how much, beside what it was; as a page, for ParaView, or for a report."""
