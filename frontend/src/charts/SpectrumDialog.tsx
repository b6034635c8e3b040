/** Power density or amplitude over frequency of what was in sight, or between the cursors, when it was opened. */

import { Modal, NativeSelect, SegmentedControl, useComputedColorScheme } from "@mantine/core";
import { useEffect, useMemo, useRef, useState } from "react";
import uPlot from "uplot";
import { fixed, significant } from "../samples/format";
import { longestWhole, type Spectrum, welch } from "../samples/spectrum";
import type { SampleTable } from "../samples/table";
import { dashOf, type Panel, paintOf } from "../theme/signals";
import { PERIOD_S } from "../wire/sample.gen";
import { readColours } from "./colours";
import { decadeRange } from "./range";
import styles from "./Spectrum.module.css";
import { logLabels } from "./ticks";

type Quantity = "density" | "amplitude";

interface SpectrumDialogProps {
  readonly panels: readonly Panel[];
  /** Taken when the dialog was opened; null while it is closed. */
  readonly table: SampleTable | null;
  onClose(): void;
}

export function SpectrumDialog({ panels, table, onClose }: SpectrumDialogProps) {
  return (
    <Modal opened={table !== null} onClose={onClose} title="Spectrum" size={860}>
      {table !== null && <Content panels={panels} table={table} />}
    </Modal>
  );
}

function Content({ panels, table }: { panels: readonly Panel[]; table: SampleTable }) {
  const [title, setTitle] = useState(panels[0]?.title ?? "");
  const [quantity, setQuantity] = useState<Quantity>("density");
  const panel = panels.find((one) => one.title === title) ?? (panels[0] as Panel);
  const spectra = useMemo(() => spectraOf(panel, table), [panel, table]);
  const first = spectra.find((spectrum) => spectrum !== null);
  const length_s = (table.t.at(-1) ?? 0) - (table.t[0] ?? 0);
  const unit = quantity === "density" ? `(${panel.unit})²/Hz` : panel.unit;
  return (
    <div className={styles.content}>
      <div className={styles.choices}>
        <NativeSelect
          aria-label="Chart"
          data={panels.map((one) => one.title)}
          value={panel.title}
          onChange={(event) => setTitle(event.currentTarget.value)}
        />
        <SegmentedControl
          size="xs"
          aria-label="Quantity"
          value={quantity}
          onChange={(value) => setQuantity(value as Quantity)}
          data={[
            { value: "density", label: "Power density" },
            { value: "amplitude", label: "Amplitude" },
          ]}
        />
        {panel.traces.map((trace) => (
          <span key={trace.name} className={styles.key}>
            <span style={{ background: paintOf(trace.hue), opacity: trace.dashed ? 0.5 : 1 }} /> {trace.name}
          </span>
        ))}
      </div>
      {first === undefined ? (
        <p className={styles.empty}>
          {table.raw
            ? "Too few samples without a gap: show at least 0.1 s."
            : "Only the extremes of this stretch are here: zoom in until single samples show (about 4 s)."}
        </p>
      ) : (
        <>
          <SpectrumPlot panel={panel} spectra={spectra} quantity={quantity} />
          <output className={styles.foot} aria-label="Spectrum facts">
            {unit} over Hz; {fixed(length_s, 3)} s, {first.segments} Hann windows that overlap by half,
            resolution {significant(first.frequencies[0] ?? Number.NaN, 3)} Hz
          </output>
        </>
      )}
    </div>
  );
}

function spectraOf(panel: Panel, table: SampleTable): (Spectrum | null)[] {
  return panel.traces.map((trace) => {
    const column = table.columns.find((one) => one.name === trace.name);
    if (!table.raw || column === undefined) return null;
    return welch(
      longestWhole(column.minimum).map((value) => value * panel.factor),
      PERIOD_S,
    );
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
  return <div ref={host} className={styles.plot} role="img" aria-label={`Spectrum of ${panel.title}`} />;
}

/** Spectra on one frequency axis, which they share unless one had a gap; zeros cannot be drawn on a log axis. */
function aligned(spectra: readonly Spectrum[], quantity: Quantity): uPlot.AlignedData {
  const tables = spectra.map(
    (spectrum): uPlot.AlignedData => [
      spectrum.frequencies,
      Array.from(spectrum[quantity], (value) => (value > 0 ? value : null)),
    ],
  );
  return uPlot.join(tables);
}
