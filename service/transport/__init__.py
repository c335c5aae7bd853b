"""Networks that carry frames in and states out. One network is one file; `protocol.py` says what it must do."""
