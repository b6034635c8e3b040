/** Curves of a drawing in fewer letters, for sending: steps from point to point, to a tenth of a unit. Pure. */

/** A curve as a sheet has it: points, each with its letter. */
const CURVE = / d="(M[ML\d .-]*)"/g;
const POINT = /([ML])(-?[\d.]+) (-?[\d.]+)/g;
/** Steps to the unit, which is a fifth of a millimetre in print. */
const FINE = 10;

export function withShortPaths(svg: string): string {
  return svg.replaceAll(CURVE, (_, points: string) => ` d="${shortened(points)}"`);
}

function shortened(points: string): string {
  const parts: string[] = [];
  let [x, y, level] = [0, 0, 0];
  /** What goes on level becomes one step. */
  function levelled(): void {
    if (level !== 0) parts.push(`h${written(level)}`);
    level = 0;
  }
  for (const [, letter, ...place] of points.matchAll(POINT)) {
    // of whole steps, so that roundings do not add up
    const [toX, toY] = place.map((part) => Math.round(Number(part) * FINE)) as [number, number];
    const [dx, dy] = [toX - x, toY - y];
    const goesOn = letter === "L" && dy === 0 && level * dx >= 0;
    if (!goesOn) levelled();
    if (letter === "M") parts.push(`M${toX / FINE} ${toY / FINE}`);
    else if (goesOn) level += dx;
    else if (dy === 0) level = dx;
    else if (dx === 0) parts.push(`v${written(dy)}`);
    else parts.push(`l${written(dx)}${dy < 0 ? "" : " "}${written(dy)}`);
    [x, y] = [toX, toY];
  }
  levelled();
  return parts.join("");
}

function written(steps: number): string {
  return String(steps / FINE).replace(/^(-?)0\./, "$1.");
}
