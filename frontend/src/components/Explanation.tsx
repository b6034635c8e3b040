/** Tooltip with the explanation of a term: one for the page, next to the term and never over the header. */

import { useEffect, useId, useLayoutEffect, useMemo, useRef } from "react";
import { createPortal } from "react-dom";
import { localizeText, readingOf } from "../samples/quantity";
import { useAngleUnit } from "../service/api/preferences";
import { useDescribedBy } from "../service/forms/refusals";
import {
  closeExplanation,
  type Entry,
  type Explained,
  KIND_TITLES,
  keepExplanation,
  pointerLeft,
  useExplained,
} from "../service/glossary";
import styles from "./Explained.module.css";
import { TEXTS } from "./texts";
import { SymbolText } from "./values";

/** Glossary entry, as the tooltip and the glossary page show it. */

/** Kinds whose terms are symbols in the paper's notation. */
const SYMBOLS: ReadonlySet<string> = new Set(["signal", "quantity", "parameter"]);

export function EntryText({ entry, listed = false }: { entry: Entry; listed?: boolean }) {
  const angles = useAngleUnit();
  const { term, name, unit, meaning, equation, source, more } = entry;
  return (
    <div className={styles.entry}>
      <div className={styles.head}>
        <span className={styles.name}>
          {SYMBOLS.has(entry.kind) && !term.includes(".") ? <SymbolText name={term} /> : term}
        </span>
        {unit && <span className={styles.unit}>[{readingOf(unit, angles).unit}]</span>}
        {listed ? (
          name !== term && <code className={styles.kind}>{name}</code>
        ) : (
          <span className={styles.kind}>{KIND_TITLES[entry.kind]}</span>
        )}
      </div>
      <p className={styles.meaning}>{localizeText(meaning, angles)}</p>
      {equation && <p className={styles.equation}>{equation}</p>}
      {more && (
        <dl className={styles.more}>
          {more.map(([heading, text]) => (
            <div key={heading}>
              <dt>{heading}</dt>
              <dd>{localizeText(text, angles)}</dd>
            </div>
          ))}
        </dl>
      )}
      {source && <p className={styles.source}>{source}</p>}
    </div>
  );
}

const GAP = 6;
const EDGE = 8;

export function Explanation() {
  const shown = useExplained();
  return shown === null ? null : createPortal(<Tooltip shown={shown} />, document.body);
}

function Tooltip({ shown }: { shown: Explained }) {
  const { anchor, entries, by } = shown;
  const id = useId();
  const element = useRef<HTMLDivElement>(null);
  const described = useMemo(() => ({ current: anchor }), [anchor]);
  useDescribedBy(described, id);

  useLayoutEffect(() => {
    const follow = () => element.current !== null && place(element.current, anchor);
    follow();
    document.addEventListener("scroll", follow, { capture: true, passive: true });
    window.addEventListener("resize", follow);
    return () => {
      document.removeEventListener("scroll", follow, { capture: true });
      window.removeEventListener("resize", follow);
    };
  }, [anchor]);

  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.key !== "Escape") return;
      event.stopPropagation(); // closes only the explanation, not the dialog below it
      closeExplanation();
    };
    const onPress = (event: PointerEvent) => {
      const at = event.target as Node;
      if (!anchor.contains(at) && element.current?.contains(at) !== true) closeExplanation();
    };
    const timer = setInterval(() => anchor.isConnected || closeExplanation(), 500);
    document.addEventListener("keydown", onKey, { capture: true });
    document.addEventListener("pointerdown", onPress, { capture: true });
    return () => {
      clearInterval(timer);
      document.removeEventListener("keydown", onKey, { capture: true });
      document.removeEventListener("pointerdown", onPress, { capture: true });
    };
  }, [anchor]);

  return (
    <div
      ref={element}
      id={id}
      role="tooltip"
      className={styles.explanation}
      onPointerEnter={keepExplanation}
      onPointerLeave={pointerLeft}
    >
      {entries.map((entry) => (
        <EntryText key={`${entry.kind}:${entry.name}`} entry={entry} />
      ))}
      {by === "focus" && <p className={styles.keys}>{closes(anchor)}</p>}
    </div>
  );
}

function closes(anchor: HTMLElement): string {
  return anchor.matches("input, select") ? TEXTS.explanationKeysOfBox : TEXTS.explanationKeys;
}

/**
 * Positions the tooltip: above a box; below a term, or above it if there is no space; at the right of a table cell,
 * so that the next row remains visible. The tooltip is always within the window and below the header.
 */
function place(tooltip: HTMLElement, anchor: HTMLElement): void {
  const at = anchor.getBoundingClientRect();
  const { width, height } = tooltip.getBoundingClientRect();
  const head = document.querySelector("header")?.getBoundingClientRect().bottom ?? 0;
  const [right, bottom] = [window.innerWidth - EDGE, window.innerHeight - EDGE];
  const isRight = anchor.closest("td, tr > th:only-of-type") !== null && at.right + GAP + width <= right;
  const above = at.top - GAP - height;
  const under = at.bottom + GAP;
  const fitsAbove = above >= head + GAP;
  // below a box its refusal is shown, and the next box follows
  const prefersAbove = anchor.matches("input, select, textarea") && fitsAbove;
  const vertical = isRight
    ? at.top
    : !prefersAbove && (under + height <= bottom || !fitsAbove)
      ? under
      : above;
  tooltip.style.top = `${Math.max(Math.min(vertical, bottom - height), head + GAP)}px`;
  tooltip.style.left = `${Math.max(EDGE, Math.min(isRight ? at.right + GAP : at.left, right - width))}px`;
}
