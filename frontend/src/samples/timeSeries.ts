/** Time ranges and tables of samples, for computation and export. Pure. */

/** Time range [s]. */
export interface TimeRange {
  readonly from_s: number;
  readonly to_s: number;
}

/** Samples of several signals over one time range. Pure. */

export interface Column {
  readonly name: string;
  /** SI; NaN for a missing sample. For raw samples both arrays are the same. */
  readonly minimum: Float64Array;
  readonly maximum: Float64Array;
}

export interface SampleTable {
  /** True for every sample of the range; false for the extremes of buckets. */
  readonly raw: boolean;
  /** Duration of a row: the sampling period, or the length of a bucket [s]. */
  readonly width_s: number;
  /** Start of each row [s]. */
  readonly t: Float64Array;
  readonly columns: readonly Column[];
}

/** Returns the table as CSV in SI, with the unit in each heading; an envelope has two columns per signal. */
export function toCsv(table: SampleTable, unitOf: (name: string) => string): string {
  const series: { title: string; values: Float64Array }[] = table.columns.flatMap(
    ({ name, minimum, maximum }) => {
      const title = (kind: string) => `${name}${kind} [${unitOf(name)}]`;
      if (table.raw) return [{ title: title(""), values: minimum }];
      return [
        { title: title("_min"), values: minimum },
        { title: title("_max"), values: maximum },
      ];
    },
  );
  const lines = [["t [s]", ...series.map(({ title }) => title)].join(",")];
  for (const [row, t] of table.t.entries()) {
    const cells = series.map(({ values }) => cell(values[row] as number));
    lines.push([Number(t.toFixed(6)), ...cells].join(","));
  }
  return `${lines.join("\n")}\n`;
}

function cell(value: number): string {
  return Number.isFinite(value) ? String(Number(value.toPrecision(7))) : "";
}
