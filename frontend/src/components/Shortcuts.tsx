import { Button, Kbd, Modal, Table } from "@mantine/core";
import type { FormEvent } from "react";
import { Link } from "wouter";
import { usePreferences } from "../service/api/preferences";
import { closeExplanation, type Entry } from "../service/glossary";
import { explaining, type Handlers } from "./Explained";
import { usePages } from "./Navigation";

/** What the keys do. */

type Keys = readonly (readonly [string[], string])[];

const STOP: Keys = [[["Ctrl/⌘", "Shift", "E"], "STOP: zero volts at once, from anywhere, text fields too"]];
const KEYS: Keys = [
  [["C"], "Set-up: what is done, missing and out of date"],
  [["L"], "Operate: follow the newest sample (Live)"],
  [["Space"], "Operate: hold the charts, go on"],
  [["M"], "Operate: measuring cursors"],
  [["Ctrl", "Wheel"], "Charts: zoom time; hold V for the value axis, B for both"],
  [["←", "→"], "Chart in focus: pan; ↑ ↓ zoom, Home resets"],
  [["Enter"], "Chart in focus: show it alone; Esc shows all"],
  [["G"], "Glossary: what every symbol, figure, verdict and fault means"],
  [["D"], "Docs: the first hour, and everything else that is written, with a search"],
  [["?"], "This list"],
];

export function Shortcuts({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  const { change } = usePreferences();
  const pages = usePages().map(({ key, name }): Keys[number] => [[key.toUpperCase()], `Go to ${name}`]);
  return (
    <Modal opened={opened} onClose={onClose} title="Keyboard shortcuts" size="lg">
      <Button
        variant="default"
        size="compact-sm"
        mb="sm"
        onClick={() => {
          change({ toured: false });
          onClose();
        }}
      >
        Show the tour again
      </Button>
      <Button
        component={Link}
        href="/glossary"
        variant="default"
        size="compact-sm"
        mb="sm"
        ml="xs"
        onClick={onClose}
      >
        Glossary
      </Button>
      <Button
        component={Link}
        href="/docs"
        variant="default"
        size="compact-sm"
        mb="sm"
        ml="xs"
        onClick={onClose}
      >
        Docs
      </Button>
      <Table withRowBorders={false}>
        <Table.Tbody>
          {[...STOP, ...pages, ...KEYS].map(([keys, meaning]) => (
            <Table.Tr key={meaning}>
              <Table.Td w={180}>
                {keys.map((key, index) => (
                  <span key={key}>
                    {index > 0 && " + "}
                    <Kbd>{key}</Kbd>
                  </span>
                ))}
              </Table.Td>
              <Table.Td>{meaning}</Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Modal>
  );
}

/** A box says what it is for when it is pointed at or focused, and is silent while something is typed. */

/** Of the control itself, which keeps its place in the order of the Tab key; nothing without an entry. */
export function help(entry: Entry | undefined): Handlers {
  if (entry === undefined) return {};
  return {
    ...explaining([entry]),
    onInput: (event: FormEvent<HTMLElement>) => closeExplanation(event.currentTarget),
  };
}
