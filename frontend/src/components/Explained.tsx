/** A word that says what it means when it is pointed at, focused or tapped; what it means comes from the glossary. */

import {
  type FocusEvent,
  type HTMLAttributes,
  type PointerEvent,
  type ReactNode,
  useEffect,
  useState,
} from "react";
import { close, current, explain, left } from "../service/explaining";
import { type Entry, entryOf } from "../service/glossary";
import styles from "./Explained.module.css";
import { useGroup, useTabStop } from "./Terms";

/** A key of the glossary, an entry, or several that are explained together; what is not known is left out. */
export type Meaning = string | Entry | undefined | readonly (Entry | undefined)[];

export function entriesOf(of: Meaning): readonly Entry[] {
  const listed = typeof of === "string" ? [entryOf(of)] : Array.isArray(of) ? of : [of as Entry | undefined];
  return listed.filter((entry) => entry !== undefined);
}

export type Handlers = Pick<
  HTMLAttributes<HTMLElement>,
  "onPointerEnter" | "onPointerLeave" | "onFocus" | "onBlur" | "onInput"
>;

/** For a control that is a word of the glossary too, as a switch of a legend: its own keys and taps stay its own. */
export function explaining(entries: readonly Entry[]): Handlers {
  if (entries.length === 0) return {};
  return {
    onPointerEnter(event: PointerEvent<HTMLElement>) {
      if (event.pointerType !== "touch") explain({ anchor: event.currentTarget, entries, by: "pointer" });
    },
    onPointerLeave: left,
    onFocus(event: FocusEvent<HTMLElement>) {
      const anchor = event.currentTarget;
      if (anchor.matches(":focus-visible")) explain({ anchor, entries, by: "focus" });
    },
    onBlur: (event: FocusEvent<HTMLElement>) => close(event.currentTarget),
  };
}

interface ExplainedProps {
  readonly of: Meaning;
  /** Without a line below: a whole sentence, or what is striking anyway. */
  readonly quiet?: boolean;
  readonly children: ReactNode;
}

export function Explained({ of, quiet = false, children }: ExplainedProps) {
  const entries = entriesOf(of);
  if (entries.length === 0) return <>{children}</>;
  return (
    <Term entries={entries} quiet={quiet}>
      {children}
    </Term>
  );
}

function Term({
  entries,
  quiet,
  children,
}: {
  entries: readonly Entry[];
  quiet: boolean;
  children: ReactNode;
}) {
  const group = useGroup();
  const [term, setTerm] = useState<HTMLElement | null>(null);
  const stop = useTabStop(group, term);
  useEffect(() => (term === null ? undefined : group?.add(term)), [group, term]);
  const { onFocus, ...handlers } = explaining(entries);
  return (
    <dfn
      ref={setTerm}
      className={styles.term}
      data-quiet={quiet}
      tabIndex={stop ? 0 : -1}
      {...handlers}
      onFocus={(event) => {
        group?.enter(event.currentTarget);
        onFocus?.(event);
      }}
      onClick={(event) => {
        const anchor = event.currentTarget;
        if (current()?.anchor === anchor && current()?.by === "tap") close(anchor);
        else explain({ anchor, entries, by: "tap" });
      }}
      onKeyDown={(event) => {
        if (event.key === "Enter") explain({ anchor: event.currentTarget, entries, by: "focus" });
        else group?.move(event);
      }}
    >
      {children}
    </dfn>
  );
}
