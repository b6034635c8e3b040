/** Writes frames the way the service does, for tests. */

export function encodeFrame(
  firstTick: number,
  missed: number,
  columns: readonly (readonly number[])[],
): ArrayBuffer {
  const count = columns[0]?.length ?? 0;
  const message = new ArrayBuffer(16 + 4 * count * columns.length);
  const view = new DataView(message);
  view.setBigUint64(0, BigInt(firstTick), true);
  view.setUint32(8, count, true);
  view.setUint32(12, missed, true);
  for (const [column, values] of columns.entries()) {
    for (const [row, value] of values.entries())
      view.setFloat32(16 + 4 * (column * count + row), value, true);
  }
  return message;
}
