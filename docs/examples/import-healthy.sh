for n in 1 2 3 4 5 6; do
  gear-twin import mapping.toml --source healthy-$n.csv --out healthy-$n.mcap
done
