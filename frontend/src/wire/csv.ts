/** Samples of an exported file. Pure. */

/** By column; comments of the file are passed over. */
export type Columns = Readonly<Record<string, Float64Array>>;

export function fromCsv(text: string): Columns {
  const lines = text.split("\n").filter((line) => line !== "" && !line.startsWith("#"));
  const names = (lines[0] ?? "").split(",");
  const columns = names.map(() => new Float64Array(Math.max(0, lines.length - 1)));
  for (let row = 1; row < lines.length; row += 1) {
    const cells = (lines[row] as string).split(",");
    for (const [place, column] of columns.entries()) column[row - 1] = Number(cells[place]);
  }
  return Object.fromEntries(names.map((name, place) => [name, columns[place] as Float64Array]));
}
