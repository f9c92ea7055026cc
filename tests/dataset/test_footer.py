"""Parquet files without a footer: whatever is whole in them is read again."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import given, settings
from hypothesis import strategies as st
from support.dataset_samples import any_dataset, recorded

from nas_data.dataset import parquet_thrift
from nas_data.dataset.parquet_footer import rebuild_footer, walk


def without_footer(table, groups, **options):
    """Write a table row group by row group and cut the footer off, as a killed writer does."""
    stream = io.BytesIO()
    with pq.ParquetWriter(stream, table.schema, **options) as writer:
        row = 0
        for rows in groups:
            writer.write_table(table.slice(row, rows), row_group_size=max(rows, 1))
            row += rows
    content = stream.getvalue()
    return content[: len(content) - 8 - int.from_bytes(content[-8:-4], "little")]


def table_of(dataset):
    columns = {}
    for key, column in dataset.columns.items():
        flat = pa.array(np.ascontiguousarray(column).reshape(-1))
        width = column.shape[1]
        columns[key] = flat if width == 1 else pa.FixedSizeListArray.from_arrays(flat, width)
    return pa.table(columns)


@settings(max_examples=20, deadline=None)
@given(any_dataset(), st.booleans(), st.sampled_from(["1.0", "2.0"]), st.data())
def test_the_footer_is_made_again_for_all_whole_row_groups(dataset, dictionary, version, data):
    table, widths = table_of(dataset), [column.shape[1] for column in dataset.columns.values()]
    lengths = dataset.lengths.tolist()
    options = {"use_dictionary": dictionary, "data_page_version": version}
    content = without_footer(table, lengths, **options)
    ends = [0, *np.cumsum(lengths).tolist()]
    sizes = [len(without_footer(table, lengths[:count], **options)) for count in range(len(lengths) + 1)]
    cut = data.draw(st.integers(0, len(content)) | st.sampled_from(sizes))
    stream = io.BytesIO()
    pq.write_table(table.slice(0, 1), stream)
    mended, groups = rebuild_footer(content[:cut], stream.getvalue(), widths)
    whole = sum(size <= cut for size in sizes[1:])
    assert groups == whole
    if groups:
        again = pq.read_table(io.BytesIO(mended))
        assert again.equals(table.slice(0, ends[groups]).cast(again.schema))


def test_columns_of_many_pages_are_put_together(tmp_path):
    rng = np.random.default_rng(0)
    table = pa.table({"a": rng.normal(size=70_000), "b": rng.integers(0, 5, 70_000)})
    content = without_footer(table, [70_000], data_page_size=4096)
    assert len(list(walk(content))) > 20
    stream = io.BytesIO()
    pq.write_table(table.slice(0, 1), stream)
    mended, groups = rebuild_footer(content, stream.getvalue(), [1, 1])
    assert groups == 1 and pq.read_table(io.BytesIO(mended)).equals(table)


@given(st.binary(max_size=200))
def test_noise_is_no_page(noise):
    assert rebuild_footer(b"PAR1" + noise, TEMPLATE, [1])[1] == 0
    list(walk(noise))


def _template():
    stream = io.BytesIO()
    pq.write_table(pa.table({"a": [1.0]}), stream)
    return stream.getvalue()


TEMPLATE = _template()


def test_thrift_structures_are_written_as_they_were_read():
    stream = io.BytesIO()
    table = table_of(recorded()).replace_schema_metadata({"note": "ä" * 300})
    pq.write_table(table, stream, write_page_index=True, sorting_columns=[pq.SortingColumn(0)])
    content = stream.getvalue()
    start = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    fields, end = parquet_thrift.parse(content, start)
    assert end == len(content) - 8
    assert parquet_thrift.serialize(parquet_thrift.Struct(fields)) == content[start:end]


@given(st.binary(max_size=100), st.integers(0, 100))
def test_noise_is_a_structure_or_a_value_error(noise, place):
    try:
        parquet_thrift.parse(noise, place)
    except ValueError:
        return
