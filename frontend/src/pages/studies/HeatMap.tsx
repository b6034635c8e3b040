/** A map as a picture: a cell for each pair of values, its colour between the numbers at the ends of the scale. */

import { digitsApart, settingValue, short } from "../../samples/format";
import { type Cell, type Cells, cellsOf, ticksOf } from "./heatCells";
import styles from "./Studies.module.css";

export interface Axis {
  readonly label: string;
  readonly values: readonly (number | string | boolean)[];
}

interface HeatMapProps {
  readonly title: string;
  readonly x: Axis;
  readonly y: Axis;
  /** By place of y, then of x. */
  readonly cells: Cells;
  /** Where there is no number because the loop of a run is unstable, by the same places. */
  readonly unstable: readonly (readonly boolean[])[];
  /** Of which runs each cell is, and of a share its interval, by the same places; "" where there is nothing to say. */
  readonly notes: readonly (readonly string[])[];
}

const WIDTH = 420;
const HEIGHT = 300;
const LEFT = 62;
const BOTTOM = 40;
const SCALE = 96;
const TOP = 8;
/** Half the distance [px] of a number and the note below it, and the room that both take in a cell. */
const APART = 7;
const ROOM_NOTE_X = 62;
const ROOM_NOTE_Y = 30;

export function HeatMap({ title, x, y, cells, unstable, notes }: HeatMapProps) {
  const width = WIDTH - LEFT - SCALE;
  const height = HEIGHT - TOP - BOTTOM;
  const { range, digits, drawn } = cellsOf(cells, width, height);
  const noteOf = ({ row, column }: Cell) => notes[row]?.[column] ?? "";
  const isNoted = (cell: Cell) =>
    noteOf(cell) !== "" && cell.width >= ROOM_NOTE_X && cell.height >= ROOM_NOTE_Y;
  const textAt = (cell: Cell) => cell.top + cell.height / 2 - (isNoted(cell) ? APART : 0);
  const [namesX, namesY] = [namesOf(x), namesOf(y)];
  const atX = (place: number) => LEFT + ((place + 0.5) * width) / x.values.length;
  const atY = (place: number) => TOP + height - ((place + 0.5) * height) / y.values.length;
  return (
    <figure className={styles.map} aria-label={title}>
      <figcaption>{title}</figcaption>
      <svg
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        role="img"
        aria-label={`${title} over ${x.label} and ${y.label}`}
      >
        <g transform={`translate(${LEFT} ${TOP})`}>
          {drawn.map((cell) => (
            <g key={cell.key}>
              <rect
                x={cell.left}
                y={cell.top}
                width={cell.width}
                height={cell.height}
                fill={cell.colour ?? "var(--sunken)"}
              >
                <title>{`${x.label} ${namesX[cell.column]}, ${y.label} ${namesY[cell.row]}: ${
                  cell.value === null
                    ? unstable[cell.row]?.[cell.column]
                      ? "the loop of a run is unstable"
                      : "no run gave a number"
                    : short(cell.value, digits)
                }${noteOf(cell) === "" ? "" : ` (${noteOf(cell)})`}`}</title>
              </rect>
              {unstable[cell.row]?.[cell.column] && (
                <text
                  x={cell.left + cell.width / 2}
                  y={textAt(cell)}
                  className={styles.inside}
                  fill="var(--text)"
                >
                  ∞
                </text>
              )}
              {cell.text !== "" && (
                <text
                  x={cell.left + cell.width / 2}
                  y={textAt(cell)}
                  className={styles.inside}
                  fill={cell.ink}
                >
                  {cell.text}
                </text>
              )}
              {isNoted(cell) && (
                <text
                  x={cell.left + cell.width / 2}
                  y={cell.top + cell.height / 2 + APART}
                  className={styles.note}
                  fill={cell.ink}
                >
                  {noteOf(cell)}
                </text>
              )}
            </g>
          ))}
        </g>
        {ticksOf(x.values.length).map((place) => (
          <text
            key={place}
            x={atX(place)}
            y={HEIGHT - BOTTOM + 14}
            className={styles.tick}
            textAnchor="middle"
          >
            {namesX[place]}
          </text>
        ))}
        {ticksOf(y.values.length).map((place) => (
          <text key={place} x={LEFT - 6} y={atY(place)} dy="0.35em" className={styles.tick} textAnchor="end">
            {namesY[place]}
          </text>
        ))}
        <text x={LEFT + width / 2} y={HEIGHT - 6} className={styles.label} textAnchor="middle">
          {x.label}
        </text>
        <text
          transform={`translate(12 ${TOP + height / 2}) rotate(-90)`}
          className={styles.label}
          textAnchor="middle"
        >
          {y.label}
        </text>
        {range !== null && <Scale left={WIDTH - SCALE + 16} height={height} range={range} digits={digits} />}
      </svg>
    </figure>
  );
}

/** Which colour stands for which number. */
function Scale({
  left,
  height,
  range: [low, high],
  digits,
}: {
  left: number;
  height: number;
  range: readonly [number, number];
  digits: number;
}) {
  const steps = Array.from({ length: 24 }, (_, step) => step / 23);
  const { drawn } = cellsOf(
    steps.map((step) => [step]),
    12,
    height,
  );
  return (
    <g transform={`translate(${left} ${TOP})`}>
      {drawn.map((cell) => (
        <rect
          key={cell.key}
          y={cell.top}
          width={12}
          height={cell.height + 0.5}
          fill={cell.colour ?? "none"}
        />
      ))}
      <text x={18} y={8} className={styles.tick}>
        {short(high, digits)}
      </text>
      <text x={18} y={height} className={styles.tick}>
        {short(low, digits)}
      </text>
    </g>
  );
}

/** What stands at the values of an axis, each apart from the others. */
function namesOf({ values }: Axis): string[] {
  const digits = digitsApart(values.filter((value) => typeof value === "number"));
  return values.map((value) => (typeof value === "number" ? short(value, digits) : settingValue(value)));
}
