"""The engine of all searches: cells, whoever computes, boxes narrowed and halved, documents; and what is tried."""
