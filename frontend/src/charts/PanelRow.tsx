import { ActionIcon, NativeSelect } from "@mantine/core";
import { type ReactNode, useEffect, useRef } from "react";
import { TbArrowDown, TbArrowUp, TbMinus, TbPlus, TbTrash, TbX } from "react-icons/tb";
import { CommittedTextInput } from "../components/fields";
import { SymbolText } from "../components/values";
import { fixed } from "../samples/format";
import { fillText } from "../samples/texts";
import { useDerived } from "../service/api/formulas";
import {
  type Edited,
  LEAST_SHARE,
  MOST,
  neighbour,
  resized,
  withOver,
  withoutPanel,
  withoutSignal,
  withSignal,
  withTitle,
} from "../theme/layouts";
import { dashOf, paintOf, type Trace, unitOf } from "../theme/signals";
import type { ChartLayout, ChartPanel } from "../wire/types";
import chartsStyles from "./Charts.module.css";
import layoutEditorStyles from "./LayoutEditor.module.css";
import type { Readout } from "./readout";
import { signalChoices } from "./SignalTree";
import { TEXTS } from "./texts";

/** Row of one panel in the layout editor. */

interface PanelRowProps {
  readonly layout: ChartLayout;
  readonly panel: ChartPanel;
  readonly place: number;
  onEdit(how: (layout: ChartLayout) => Edited): void;
  onMove(by: 1 | -1): void;
}

/** Target row and direction of the last move; the focus moves with the panel. */
let lastMove: { readonly place: number; readonly by: 1 | -1 } | null = null;

export function PanelRow({ layout, panel, place, onEdit, onMove }: PanelRowProps) {
  const { title, signals, over, share } = panel;
  const row = useRef<HTMLLIElement>(null);
  const derived = useDerived();
  // biome-ignore lint/correctness/useExhaustiveDependencies: the effect runs when another panel is in this row
  useEffect(() => {
    if (lastMove?.place !== place) return;
    const [direction, other] = lastMove.by < 0 ? ["up", "down"] : ["down", "up"];
    lastMove = null;
    const button = (name = "") =>
      row.current?.querySelector<HTMLElement>(`[data-move=${name}]:not(:disabled)`);
    (button(direction) ?? button(other))?.focus();
  }, [title, place]);

  function move(by: 1 | -1): void {
    const to = neighbour(layout, place, by);
    if (to === null) return;
    lastMove = { place: to, by };
    onMove(by);
  }

  return (
    <li ref={row} className={layoutEditorStyles.panel} aria-label={title} data-panel-row={place}>
      <CommittedTextInput
        label={fillText(TEXTS.titleOf, { number: place + 1 })}
        text={title}
        onDone={(text) => onEdit((now) => withTitle(now, place, text))}
      />
      <span className={layoutEditorStyles.signals}>
        {signals.map((name) => (
          <button
            key={name}
            type="button"
            className={layoutEditorStyles.signal}
            aria-label={fillText(TEXTS.removeSignal, { signal: name, panel: title })}
            onClick={() => onEdit((now) => withoutSignal(now, place, name))}
          >
            <SymbolText name={name} /> <TbX size={12} aria-hidden="true" />
          </button>
        ))}
      </span>
      <NativeSelect
        aria-label={fillText(TEXTS.addSignalTo, { panel: title })}
        value=""
        onChange={({ currentTarget: { value } }) => onEdit((now) => withSignal(now, place, value))}
        data={[
          { value: "", label: TEXTS.addSignal, disabled: true },
          ...signalChoices(unitOf(signals[0] ?? ""), derived),
        ]}
        w={130}
      />
      <NativeSelect
        aria-label={fillText(TEXTS.axisOf, { panel: title })}
        value={over ?? ""}
        onChange={({ currentTarget: { value } }) => onEdit((now) => withOver(now, place, value || null))}
        data={[{ value: "", label: TEXTS.overTime }, ...signalChoices(null, derived)]}
        w={110}
      />
      <span className={layoutEditorStyles.tools}>
        <Tool
          name={fillText(TEXTS.lower, { panel: title })}
          idle={share <= LEAST_SHARE}
          onClick={() => onEdit((now) => resized(now, place, -1))}
        >
          <TbMinus size={14} />
        </Tool>
        <output className={layoutEditorStyles.share} aria-label={fillText(TEXTS.heightOf, { panel: title })}>
          × {fixed(share, 1)}
        </output>
        <Tool
          name={fillText(TEXTS.higher, { panel: title })}
          idle={share >= MOST.share}
          onClick={() => onEdit((now) => resized(now, place, 1))}
        >
          <TbPlus size={14} />
        </Tool>
        <Tool
          name={fillText(TEXTS.moveUp, { panel: title })}
          move="up"
          idle={neighbour(layout, place, -1) === null}
          onClick={() => move(-1)}
        >
          <TbArrowUp size={14} />
        </Tool>
        <Tool
          name={fillText(TEXTS.moveDown, { panel: title })}
          move="down"
          idle={neighbour(layout, place, 1) === null}
          onClick={() => move(1)}
        >
          <TbArrowDown size={14} />
        </Tool>
        <Tool
          name={fillText(TEXTS.removePanel, { panel: title })}
          idle={false}
          onClick={() => onEdit((now) => withoutPanel(now, place))}
        >
          <TbTrash size={14} />
        </Tool>
      </span>
    </li>
  );
}

interface ToolProps {
  readonly name: string;
  readonly idle: boolean;
  readonly move?: string;
  readonly children: ReactNode;
  onClick(): void;
}

function Tool({ name, idle, move, children, onClick }: ToolProps) {
  return (
    <ActionIcon
      variant="default"
      size={28}
      aria-label={name}
      title={name}
      disabled={idle}
      data-move={move}
      onClick={onClick}
    >
      {children}
    </ActionIcon>
  );
}

/** Line under the pointer, and two measuring cursors, which mouse and arrow keys move. */

interface MeasureCursorsProps {
  readonly readout: Readout;
  readonly measuring: boolean;
  span_s(): number;
}

export function MeasureCursors({ readout, measuring, span_s }: MeasureCursorsProps) {
  return (
    <>
      <div className={chartsStyles.cursor} data-role="hover" aria-hidden="true">
        <span className={chartsStyles.lineTime} data-role="hover-time" />
        <span className={chartsStyles.lineMarks} data-role="marks" hidden />
      </div>
      {([0, 1] as const).map((cursor) => (
        <div
          key={cursor}
          className={chartsStyles.measure}
          data-role={`cursor-${cursor}`}
          role="slider"
          aria-label={fillText(TEXTS.cursor, { number: cursor + 1 })}
          aria-valuenow={0}
          tabIndex={measuring ? 0 : -1}
          onKeyDown={(event) => {
            const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
            if (by === undefined) return;
            event.preventDefault();
            const share = event.shiftKey ? 0.1 : 0.005;
            readout.nudge(cursor, by * share, span_s());
          }}
        >
          <span className={chartsStyles.lineTime} data-role={`cursor-${cursor}-time`} aria-hidden="true" />
        </div>
      ))}
    </>
  );
}

/** Short line in the style of a trace. */

export function TraceLine({ trace }: { trace: Trace }) {
  return (
    <svg width="18" height="8" aria-hidden="true">
      <line
        x1="0"
        x2="18"
        y1="4"
        y2="4"
        stroke={paintOf(trace.hue)}
        strokeWidth="2.5"
        strokeDasharray={dashOf(trace).join(" ") || undefined}
      />
    </svg>
  );
}
