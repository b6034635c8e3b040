import { Modal, NativeSelect, Progress, SegmentedControl, useComputedColorScheme } from "@mantine/core";
import { useEffect, useMemo, useRef, useState } from "react";
import uPlot from "uplot";
import { SignalName } from "../components/values";
import { type SignalSpectrum, type Spectra, type Spectrum, spectraOf } from "../samples/analysis";
import { fixed, significant } from "../samples/format";
import { fillText } from "../samples/texts";
import type { SampleTable, TimeRange } from "../samples/timeSeries";
import { dashOf, type Panel } from "../theme/signals";
import { PERIOD_S } from "../wire/sample.gen";
import { decadeRange, logLabels } from "./axes";
import { readColours } from "./canvas";
import { TraceLine } from "./PanelRow";
import styles from "./Spectrum.module.css";
import { describeBasis, grouped } from "./StatisticsTable";
import type { StoredData } from "./storedRuns";
import { TEXTS } from "./texts";

/** Spectra of a range: computed at once from the page's samples, or by the service. */

/** Request for a spectrum: the visible range, or that between the cursors, at the time of the request. */
export interface SpectrumOrder {
  readonly range: TimeRange;
  /** Null if the service has every sample. */
  readonly table: SampleTable | null;
  readonly stored: StoredData | null;
}

interface ShownSpectra {
  readonly spectra: Spectra | null;
  readonly share: number;
  readonly problem: string;
}

const NOTHING: ShownSpectra = { spectra: null, share: 0, problem: "" };

/** `names` must keep its identity while its content is the same. Unmounting aborts the request. */
function useSpectra({ range, table, stored }: SpectrumOrder, names: readonly string[]): ShownSpectra {
  const [shown, setShown] = useState(NOTHING);
  useEffect(() => {
    if (table !== null) {
      setShown({ ...NOTHING, spectra: spectraOf(table, names, PERIOD_S) });
      return;
    }
    if (stored === null) return;
    const request = new AbortController();
    const update = (part: Partial<ShownSpectra>) => {
      if (!request.signal.aborted) setShown((before) => ({ ...before, ...part }));
    };
    setShown(NOTHING);
    stored
      .spectra(names, range, { signal: request.signal, onShare: (share) => update({ share }) })
      .then((spectra) => update({ spectra, share: 1 }))
      .catch((error: Error) => update({ problem: error.message }));
    return () => request.abort();
  }, [range, table, stored, names]);
  return shown;
}

/** Power density or amplitude over frequency of the range at the time when the dialog was opened. */

type Quantity = "density" | "amplitude";

interface SpectrumDialogProps {
  readonly panels: readonly Panel[];
  /** Request of the dialog; null while it is closed. */
  readonly order: SpectrumOrder | null;
  /** Formats a time like the time axis. */
  timeText(time_s: number): string;
  onClose(): void;
}

export function SpectrumDialog({ panels, order, timeText, onClose }: SpectrumDialogProps) {
  return (
    <Modal opened={order !== null} onClose={onClose} title={TEXTS.spectrum} size={860}>
      {order !== null && <Content panels={panels} order={order} timeText={timeText} />}
    </Modal>
  );
}

interface ContentProps {
  readonly panels: readonly Panel[];
  readonly order: SpectrumOrder;
  timeText(time_s: number): string;
}

function Content({ panels, order, timeText }: ContentProps) {
  const [title, setTitle] = useState(panels[0]?.title ?? "");
  const [quantity, setQuantity] = useState<Quantity>("density");
  const panel = panels.find((one) => one.title === title) ?? (panels[0] as Panel);
  const names = useMemo(() => panel.traces.map((trace) => trace.name), [panel]);
  const { spectra: found, share, problem } = useSpectra(order, names);
  const spectra = useMemo(
    () => panel.traces.map((trace) => scaled(found, trace.name, panel)),
    [found, panel],
  );
  const unit = quantity === "density" ? `(${panel.unit})²/Hz` : panel.unit;
  const computed = found !== null && spectra.some((spectrum) => spectrum !== null);
  return (
    <div className={styles.content}>
      <div className={styles.choices}>
        <NativeSelect
          aria-label={TEXTS.chart}
          data={panels.map((one) => one.title)}
          value={panel.title}
          onChange={(event) => setTitle(event.currentTarget.value)}
        />
        <SegmentedControl
          size="xs"
          aria-label={TEXTS.quantity}
          value={quantity}
          onChange={(value) => setQuantity(value as Quantity)}
          data={[
            { value: "density", label: TEXTS.density },
            { value: "amplitude", label: TEXTS.amplitude },
          ]}
        />
        {panel.traces.map((trace) => (
          <span key={trace.name} className={styles.key}>
            <TraceLine trace={trace} /> <SignalName name={trace.name} />
          </span>
        ))}
      </div>
      {problem !== "" && <p className={styles.empty}>{fillText(TEXTS.notComputed, { reason: problem })}</p>}
      {problem === "" && found === null && (
        <div className={styles.empty}>
          <p>{fillText(TEXTS.spectrumReading, { percent: fixed(100 * share, 0) })}</p>
          <Progress value={100 * share} aria-label={TEXTS.spectrumProgress} />
        </div>
      )}
      {computed && <SpectrumPlot panel={panel} spectra={spectra} quantity={quantity} />}
      {found !== null && !computed && (
        <p className={styles.empty}>{fillText(TEXTS.noSpectrum, { reasons: reasonsOf(found, names) })}</p>
      )}
      {found !== null && (
        <output className={styles.foot} aria-label={TEXTS.spectrumFacts}>
          {factsOf(found, names, computed ? unit : null, timeText)}
        </output>
      )}
    </div>
  );
}

/** Text of the method of the spectra, their data basis and omissions. `unit` is null without spectra. */
function factsOf(
  found: Spectra,
  names: readonly string[],
  unit: string | null,
  timeText: (time_s: number) => string,
): string {
  const basis = fillText(TEXTS.from, { basis: describeBasis(found.basis, timeText) });
  if (unit === null) return basis;
  const excluded = excludedText(found, names);
  const reasons = reasonsOf(found, names);
  return [
    fillText(TEXTS.spectrumMethod, { unit, method: methodOf(found, names) }),
    basis,
    excluded === "" ? "" : fillText(TEXTS.excluded, { samples: excluded }),
    reasons === "" ? "" : fillText(TEXTS.noSpectrum, { reasons }),
  ]
    .filter((one) => one !== "")
    .join(" ");
}
/** Spectrum of a signal in the unit shown. */
function scaled(found: Spectra | null, name: string, { factor }: Panel): SignalSpectrum | null {
  const spectrum = found?.signals.get(name);
  if (spectrum === undefined) return null;
  return {
    ...spectrum,
    density: spectrum.density.map((value) => value * factor ** 2),
    amplitude: spectrum.amplitude.map((value) => value * Math.abs(factor)),
  };
}

/** Text of the windows of the spectra. */
function methodOf({ signals }: Spectra, names: readonly string[]): string {
  return together(names, (name) => {
    const spectrum = signals.get(name);
    if (spectrum === undefined) return [];
    const step = significant(spectrum.frequencies[0] ?? Number.NaN, 3);
    return [fillText(TEXTS.windows, { count: spectrum.segments, length: grouped(spectrum.segment), step })];
  });
}

/** Text of the samples that no spectrum contains, and of signals without power. */
function excludedText({ signals }: Spectra, names: readonly string[]): string {
  return together(names, (name) => {
    const spectrum = signals.get(name);
    if (spectrum === undefined) return [];
    const { values, withoutValue, used, density } = spectrum;
    return [
      withoutValue > 0 ? fillText(TEXTS.samplesWithoutValue, { count: grouped(withoutValue) }) : "",
      values > used ? fillText(TEXTS.samplesInNoWindow, { count: grouped(values - used) }) : "",
      density.every((value) => value === 0) ? TEXTS.constant : "",
    ].filter(Boolean);
  });
}

/** Texts of signals; a text of all signals appears once, without their names. */
function together(names: readonly string[], textsOf: (name: string) => readonly string[]): string {
  const signalsByText = new Map<string, string[]>();
  for (const name of names)
    for (const words of textsOf(name)) signalsByText.set(words, [...(signalsByText.get(words) ?? []), name]);
  return [...signalsByText]
    .map(([words, of]) =>
      of.length === names.length ? words : fillText(TEXTS.ofSignals, { signals: of.join(", "), words }),
    )
    .join("; ");
}

function reasonsOf({ reasons }: Spectra, names: readonly string[]): string {
  return together(names, (name) => {
    const reason = reasons.get(name);
    return reason === undefined ? [] : [reason];
  });
}

interface SpectrumPlotProps {
  readonly panel: Panel;
  readonly spectra: readonly (Spectrum | null)[];
  readonly quantity: Quantity;
}

function SpectrumPlot({ panel, spectra, quantity }: SpectrumPlotProps) {
  const host = useRef<HTMLDivElement>(null);
  const scheme = useComputedColorScheme("light");
  // biome-ignore lint/correctness/useExhaustiveDependencies: another colour scheme has other colours
  useEffect(() => {
    const element = host.current;
    if (element === null) return;
    const colours = readColours(element);
    const axis: uPlot.Axis = {
      stroke: colours.axis,
      grid: { stroke: colours.grid, width: 1 },
      ticks: { show: false },
      values: (_plot, splits) => logLabels(splits),
    };
    const shown = panel.traces.flatMap((trace, index) => {
      const spectrum = spectra[index];
      return spectrum ? [{ trace, spectrum }] : [];
    });
    const plot = new uPlot(
      {
        width: element.clientWidth,
        height: 340,
        legend: { show: false },
        scales: {
          x: { time: false, distr: 3 },
          y: { distr: 3, range: (_plot, min, max) => decadeRange(min, max) },
        },
        axes: [axis, { ...axis, size: 64 }],
        series: [
          {},
          ...shown.map(({ trace }) => ({
            stroke: colours.drawn(trace.hue),
            width: 1.2,
            dash: dashOf(trace),
            points: { show: false },
          })),
        ],
      },
      aligned(
        shown.map(({ spectrum }) => spectrum),
        quantity,
      ),
      element,
    );
    return () => plot.destroy();
  }, [panel, spectra, quantity, scheme]);
  return (
    <div
      ref={host}
      className={styles.plot}
      role="img"
      aria-label={fillText(TEXTS.spectrumOf, { panel: panel.title })}
    />
  );
}

/** Spectra on a common frequency axis, which differs only after gaps; a log axis omits zeros. */
function aligned(spectra: readonly Spectrum[], quantity: Quantity): uPlot.AlignedData {
  const tables = spectra.map(
    (spectrum): uPlot.AlignedData => [
      spectrum.frequencies,
      Array.from(spectrum[quantity], (value) => (value > 0 ? value : null)),
    ],
  );
  return uPlot.join(tables);
}
