import { Popover } from "@mantine/core";
import { useState } from "react";
import { TbArrowsMaximize, TbArrowsMinimize } from "react-icons/tb";
import { Explained, entriesOf, explaining } from "../components/Explained";
import { SymbolText } from "../components/values";
import { fillText } from "../samples/texts";
import { usePreferences } from "../service/api/preferences";
import { symbolEntries } from "../service/glossary";
import { PALETTE, type Panel, paintOf, signalOf, type Trace } from "../theme/signals";
import chartsStyles from "./Charts.module.css";
import colourChoiceStyles from "./ColourChoice.module.css";
import { TraceLine } from "./PanelRow";
import { TEXTS } from "./texts";

/** Line of a signal in the legend, with a choice of its colour, which the preferences store. */

function ColourChoice({ trace }: { trace: Trace }) {
  const [opened, setOpened] = useState(false);
  const { preferences, change } = usePreferences();
  const signal = signalOf(trace.name);

  function choose(hue: string | null): void {
    const { [signal]: _before, ...others } = preferences.colours;
    change({ colours: hue === null ? others : { ...others, [signal]: hue } });
    setOpened(false);
  }

  return (
    <Popover opened={opened} onChange={setOpened} position="bottom-start" withArrow trapFocus returnFocus>
      <Popover.Target>
        <button
          type="button"
          className={colourChoiceStyles.swatch}
          aria-label={fillText(TEXTS.colourOf, { signal: trace.name })}
          aria-expanded={opened}
          onClick={() => setOpened(!opened)}
        >
          <TraceLine trace={trace} />
        </button>
      </Popover.Target>
      <Popover.Dropdown p={8}>
        <div className={colourChoiceStyles.choices}>
          {PALETTE.map((hue) => (
            <button
              key={hue}
              type="button"
              className={colourChoiceStyles.hue}
              style={{ background: paintOf(hue) }}
              aria-label={fillText(TEXTS.colour, { hue })}
              aria-pressed={hue === trace.hue}
              onClick={() => choose(hue)}
            />
          ))}
          <button type="button" className={colourChoiceStyles.standard} onClick={() => choose(null)}>
            {TEXTS.defaultColour}
          </button>
        </div>
      </Popover.Dropdown>
    </Popover>
  );
}

/** Head of a chart: title, unit, and for each signal a switch with its value. */

/** Roles during measuring: values at the cursors and their difference, instead of the single value. */
const CURSORS = ["cursor-0", "cursor-1", "delta"] as const;

interface LegendProps {
  readonly panel: Panel;
  readonly hidden: ReadonlySet<string>;
  readonly onToggle: (name: string) => void;
  /** Called on hover and focus with the signal, and with null when they end. */
  readonly onHighlight: (name: string | null) => void;
  /** Whether only this panel is shown; omitted if the panel cannot be enlarged. */
  readonly enlarged?: boolean;
  readonly onEnlarge?: () => void;
}

export function Legend({ panel, hidden, onToggle, onHighlight, enlarged, onEnlarge }: LegendProps) {
  return (
    <figcaption className={chartsStyles.caption}>
      <span className={chartsStyles.title}>
        <Explained of={panel.traces.flatMap(({ name }) => symbolEntries(name))}>{panel.title}</Explained>{" "}
        {panel.unit !== "1" && <span className={chartsStyles.unit}>[{panel.unit}]</span>}
      </span>
      {onEnlarge !== undefined && (
        <button
          type="button"
          className={chartsStyles.enlarge}
          aria-label={fillText(TEXTS.enlarge, { panel: panel.title })}
          aria-pressed={enlarged === true}
          title={enlarged ? TEXTS.showAll : TEXTS.showAlone}
          onClick={onEnlarge}
        >
          {enlarged ? <TbArrowsMinimize size={15} /> : <TbArrowsMaximize size={15} />}
        </button>
      )}
      {panel.traces.map((trace) => (
        <span
          key={trace.name}
          className={chartsStyles.entry}
          onPointerEnter={() => onHighlight(trace.name)}
          onPointerLeave={() => onHighlight(null)}
        >
          {trace.ofRecording ? <TraceLine trace={trace} /> : <ColourChoice trace={trace} />}
          <button
            type="button"
            className={chartsStyles.toggle}
            aria-pressed={!hidden.has(trace.name)}
            onClick={() => onToggle(trace.name)}
            {...explaining(entriesOf(symbolEntries(trace.name)))}
          >
            <span aria-hidden="true">
              <SymbolText name={trace.name} />
            </span>
            <span className="visually-hidden">{trace.name}</span>
          </button>
          <span className={chartsStyles.value} data-role={`value-${trace.name}`} />
          {CURSORS.map((role) => (
            <span key={role} className={chartsStyles.delta} data-role={`${role}-${trace.name}`} />
          ))}
        </span>
      ))}
      {panel.over !== undefined && (
        <span className={chartsStyles.over}>
          {TEXTS.versus} <SymbolText name={panel.over.name} />
          {panel.over.unit !== "1" && <span>[{panel.over.unit}]</span>}
          <span className={chartsStyles.value} data-role="over" />
        </span>
      )}
    </figcaption>
  );
}
