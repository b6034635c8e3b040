import { NativeSelect, Table } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { type ReactNode, useCallback, useEffect, useMemo } from "react";
import { Charts } from "../../charts/Charts";
import type { LimitLine, PlacedMark } from "../../charts/decorations";
import { markOf, RecordedSource, traceOf } from "../../charts/sources";
import { useViewport, visibleRange } from "../../charts/viewport";
import { Card } from "../../components/Card";
import { DebouncedNumberField } from "../../components/fields";
import { Absent, Unit, ValueOrReason } from "../../components/values";
import { fixed, settingValue, significant } from "../../samples/format";
import { type AngleUnit, formatWithUnit, labelWith, readingOf } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { type ComparisonAsked, curvesOf, differencesQuery } from "../../service/api/runs";
import { readIn } from "../../theme/layouts";
import { type Panel, scaleOf, traceFor, unitOf } from "../../theme/signals";
import { FIELDS } from "../../wire/sample.gen";
import type { ComparedSetting, Differences, RunComparison, RunDifference } from "../../wire/types";
import pageStyles from "../Page.module.css";
import runsStyles from "./Runs.module.css";
import type { Compared } from "./runAddress";
import { TEXTS } from "./texts";

/** Table of each run's deviations: first violation of the band, time outside, largest difference. */

interface DeviationTableProps {
  readonly found: Differences;
  /** In SI; null if none is set. */
  readonly band: number | null;
}

function DeviationTable({ found, band }: DeviationTableProps) {
  const angles = useAngleUnit();
  const { factor } = readingOf(found.unit, angles);
  return (
    <div className={pageStyles.tableScroll}>
      <Table aria-label={TEXTS.deviations} verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.runColumn}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.firstViolation}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.timeOutside}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.longestViolation}</Table.Th>
            <Table.Th className={pageStyles.number}>{labelWith(TEXTS.largest, found.unit, angles)}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.largestAt}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.compared}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {found.runs.map((one) => (
            <Table.Tr key={one.run}>
              <Table.Td>{fillText(TEXTS.run, { run: one.run })}</Table.Td>
              {one.reason === "" ? (
                <Figures one={one} banded={band !== null} factor={factor} />
              ) : (
                <Table.Td colSpan={6}>{fillText(TEXTS.notMeasured, { reason: one.reason })}</Table.Td>
              )}
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

interface FiguresProps {
  readonly one: RunDifference;
  readonly banded: boolean;
  readonly factor: number;
}

function Figures({ one, banded, factor }: FiguresProps) {
  const within = (figure: ReactNode) => (banded ? figure : <Absent why={TEXTS.noTolerance} />);
  const cells = [
    within(
      <ValueOrReason value={one.left_at_s} why={TEXTS.withinTolerance}>
        {(at_s) => fixed(at_s, 3)}
      </ValueOrReason>,
    ),
    within(fixed(one.outside_s, 3)),
    within(fixed(one.longest_s, 3)),
    one.largest === null ? "" : significant(one.largest * factor, 4),
    one.largest_at_s === null ? "" : fixed(one.largest_at_s, 3),
    one.missing_s > 0
      ? fillText(TEXTS.comparedOf, {
          compared: fixed(one.compared_s, 3),
          total: fixed(one.compared_s + one.missing_s, 3),
        })
      : fixed(one.compared_s, 3),
  ];
  return cells.map((cell, place) => (
    // biome-ignore lint/suspicious/noArrayIndexKey: columns have no identity except their index
    <Table.Td key={place} className={pageStyles.number}>
      {cell}
    </Table.Td>
  ));
}

/** Table of the settings in which the compared runs differ. */

/** Longer texts are conspicuous without emphasis [characters]. */
const LONG = 40;

export function DifferingSettings({
  comparison: { settings, runs, reference },
}: {
  comparison: RunComparison;
}) {
  const angles = useAngleUnit();
  if (settings.length === 0) {
    return <p className={pageStyles.empty}>{TEXTS.sameSettings}</p>;
  }
  const place = runs.findIndex(({ id }) => id === reference);
  return (
    <div className={pageStyles.tableScroll}>
      <Table aria-label={TEXTS.differentSettings} verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.settingOrParameter}</Table.Th>
            {runs.map(({ id }) => (
              <Table.Th key={id} className={pageStyles.number}>
                {fillText(TEXTS.run, { run: id })}
              </Table.Th>
            ))}
            <Table.Th>{TEXTS.unit}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {settings.map((setting) => (
            <Table.Tr key={`${setting.name} ${setting.unit}`}>
              <Table.Td>{setting.name}</Table.Td>
              {runs.map(({ id }, index) => (
                <Table.Td key={id} className={pageStyles.number}>
                  <Value setting={setting} index={index} alike={place} angles={angles} />
                </Table.Td>
              ))}
              <Table.Td>
                <Unit unit={setting.unit} />
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

interface ValueProps {
  readonly setting: ComparedSetting;
  readonly index: number;
  /** Index of the reference; a value that differs from the reference's is emphasized. */
  readonly alike: number;
  readonly angles: AngleUnit;
}

function Value({ setting: { values, unit }, index, alike, angles }: ValueProps) {
  const value = values[index] ?? null;
  if (value === null) return <Absent why={TEXTS.notSet} />;
  const text = settingValue(typeof value === "number" ? value * readingOf(unit, angles).factor : value);
  if (value === values[alike]) return <span className={pageStyles.dim}>{text}</span>;
  return text.length > LONG ? text : <strong>{text}</strong>;
}

/** Panel of a signal's differences in the line styles of the runs, with the tolerance band. Pure. */

/** Signals with a unit; differences of codes and counts are meaningless. */
const SIGNALS = FIELDS.filter(({ unit }) => unit !== "1").map(({ name }) => name);

/** Factor by which the axis of the differences may be finer, because differences are small. */
const FINER = 20;

/** Returns the name of a run's difference with the mark of its curves; null if the run is not drawn. */
export function nameOf(signal: string, drawn: readonly number[], run: number): string | null {
  const place = drawn.indexOf(run);
  return place < 0 ? null : `Δ${signal}${markOf(place)}`;
}

/** Returns the panel with the differences of all `drawn` runs except the reference. */
export function differencePanel(
  signal: string,
  drawn: readonly number[],
  reference: number,
  angles: AngleUnit,
): Panel {
  const { hue } = traceFor(signal, []);
  const traces = drawn
    .map((_, n) => ({
      ...traceOf({ name: signal, hue, dashed: false }, n, drawn.length),
      name: `Δ${signal}${markOf(n)}`,
    }))
    .filter((_, n) => drawn[n] !== reference);
  const scale = scaleOf([signal]);
  return readIn(
    { ...scale, narrowest: scale.narrowest / FINER, title: fillText(TEXTS.differenceIn, { signal }), traces },
    angles,
  );
}

/** Returns the band, given in SI, as lines of the panel. */
export function bandLines({ traces, factor }: Panel, band: number | null): readonly LimitLine[] {
  if (band === null) return [];
  const line = (sign: 1 | -1): LimitLine => ({
    of: traces.map(({ name }) => name),
    value: sign * band * factor,
    label: sign > 0 ? TEXTS.bandAbove : TEXTS.bandBelow,
    alwaysInSight: true,
  });
  return [line(1), line(-1)];
}

/** Card with the difference of a signal to the reference run, and its violations of a tolerance band. */

const POINTS = 2000;
const RESTED_MS = 300;

interface DifferencesCardProps {
  readonly asked: ComparisonAsked;
  /** Runs that the curves above show, in the same order. */
  readonly drawn: readonly number[];
  readonly signal: string;
  /** In SI; null if none is set. */
  readonly band: number | null;
  onChange(to: Partial<Compared>): void;
}

export function DifferencesCard({ asked, drawn, signal, band, onChange }: DifferencesCardProps) {
  const angles = useAngleUnit();
  const { data, error } = useQuery(differencesQuery(asked, signal, band, POINTS));
  return (
    <Card
      title={fillText(TEXTS.differences, { run: asked.reference })}
      aside={
        <div className={pageStyles.actions}>
          <NativeSelect
            aria-label={TEXTS.signal}
            value={signal}
            data={SIGNALS.map((name) => ({ value: name, label: name }))}
            onChange={({ currentTarget: { value } }) => onChange({ signal: value, band: null })}
          />
          <DebouncedNumberField
            key={signal}
            label={TEXTS.tolerance}
            before="±"
            unit={unitOf(signal)}
            value={band}
            optional
            fits={(found) => (found >= 0 ? "" : TEXTS.notNegative)}
            onChange={(found) => onChange({ band: found })}
          />
        </div>
      }
    >
      {data === undefined ? (
        <p className={pageStyles.empty}>{error?.message ?? TEXTS.comparing}</p>
      ) : (
        <div className={runsStyles.deviations}>
          <DeviationTable found={data} band={band} />
          {data.runs.some(({ run }) => drawn.includes(run)) && (
            <div className={runsStyles.difference}>
              <DifferenceCharts key={keyOf(asked, signal)} found={data} {...{ asked, drawn, signal, band }} />
            </div>
          )}
          <p className={pageStyles.dim}>
            {fillText(TEXTS.differenceNote, { signal, run: asked.reference })}
            {band !== null &&
              ` ${fillText(TEXTS.toleranceNote, { tolerance: formatWithUnit(band, unitOf(signal), angles) })}`}
          </p>
        </div>
      )}
    </Card>
  );
}

function keyOf(asked: ComparisonAsked, signal: string): string {
  return JSON.stringify([asked, signal]);
}

interface DifferenceChartsProps extends Omit<DifferencesCardProps, "onChange"> {
  readonly found: Differences;
}

/** Charts of the differences; React remounts them for other runs or another signal. */
function DifferenceCharts({ asked, drawn, signal, band, found }: DifferenceChartsProps) {
  const angles = useAngleUnit();
  const begin_s = found.t[0] ?? 0;
  const end_s = (found.t.at(-1) ?? 0) + found.width_s;
  const home = useMemo(() => ({ span_s: end_s - begin_s, end_s }), [begin_s, end_s]);
  const control = useViewport(home);
  const source = useMemo(() => new RecordedSource(end_s), [end_s]);
  const panel = useMemo(
    () => differencePanel(signal, drawn, asked.reference, angles),
    [signal, drawn, asked.reference, angles],
  );
  const named = useCallback((run: number) => nameOf(signal, drawn, run), [signal, drawn]);
  const [view] = useDebouncedValue(control.view, RESTED_MS);
  const seen = visibleRange(view, end_s);
  const part = { from_s: Math.max(0, seen.from_s), to_s: Math.max(found.width_s, seen.to_s) };
  const { data: detail } = useQuery({
    ...differencesQuery(asked, signal, null, 2 * POINTS, part),
    enabled: !found.raw && part.to_s - part.from_s < 0.99 * home.span_s,
  });
  useEffect(() => {
    source.setOverview(curvesOf(found, named));
  }, [source, found, named]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the data belong to the range that was requested with them
  useEffect(() => {
    if (detail)
      source.setDetail(
        part,
        curvesOf(detail, (run) => nameOf(signal, drawn, run)),
      );
  }, [source, detail, signal, drawn]);
  const marks = useMemo(
    () =>
      found.runs.flatMap(({ run, left_at_s }): PlacedMark[] =>
        left_at_s === null
          ? []
          : [{ time_s: left_at_s, text: fillText(TEXTS.violation, { run }), fault: false }],
      ),
    [found],
  );
  return (
    <Charts
      panels={useMemo(() => [panel], [panel])}
      source={source}
      control={control}
      home={home}
      longest_s={home.span_s}
      limits={useMemo(() => bandLines(panel, band), [panel, band])}
      marks={marks}
      stale={false}
      origin={{ of: fillText(TEXTS.differenceFrom, { signal, run: asked.reference }), plant: "", bank: "" }}
      name={`sinew-difference-to-run-${asked.reference}`}
      remark={found.raw ? TEXTS.allSamples : TEXTS.minMaxDifference}
    />
  );
}
