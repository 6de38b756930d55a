# How often each rank of 2x is, by channel, over the parts of `gearwatch batch` in a folder: `python datafusion_ranks.py ranks/`
#
#   pip install datafusion

# %%
import sys

from datafusion import SessionContext

context = SessionContext()
context.register_parquet("parts", sys.argv[1])
frame = context.sql("select channel, rank_2x, count(*) as windows from parts group by channel, rank_2x order by channel, rank_2x")
for batch in frame.collect():
    for row in batch.to_pylist():
        print(*row.values())
