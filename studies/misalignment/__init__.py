"""A pair as bodies on shafts, integrated in time: contacts by an impact law, compliant bearings and shafts."""
