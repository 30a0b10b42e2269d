"""Methods of other papers, each written from its publication, one module each."""
