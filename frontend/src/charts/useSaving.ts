/** Saving what the charts show: a picture of it, and its data. */

import { useState } from "react";
import type { Stretch } from "../samples/stretch";
import { type SampleTable, toCsv } from "../samples/table";
import { unitOf } from "../theme/signals";
import { type PictureKind, picture, save, saveFrom, stamp } from "./save";
import { type Sheet, svgOf } from "./sheet";
import type { StoredData } from "./stored";

interface Saving {
  /** Begin of the names of files. */
  readonly name: string;
  readonly names: readonly string[];
  readonly stored: StoredData | null;
  sheet(): Sheet;
  /** The visible range, or that between the cursors. */
  range(): Stretch;
  table(): SampleTable;
}

export function useSaving({ name, names, stored, sheet, range, table }: Saving) {
  const [unsaved, setUnsaved] = useState<string | null>(null);

  async function savePicture(kind: PictureKind): Promise<void> {
    try {
      save(await picture(svgOf(sheet()), kind), `${name}-${stamp(new Date())}.${kind}`);
      setUnsaved(null);
    } catch (error) {
      setUnsaved(`The picture was not saved: ${(error as Error).message}`);
    }
  }

  /** Of a recording the service writes every sample; else the page writes what it has. */
  function saveData(): void {
    setUnsaved(null);
    if (stored === null) {
      const content = toCsv(table(), unitOf);
      save(new Blob([content], { type: "text/csv" }), `${name}-${stamp(new Date())}.csv`);
      return;
    }
    const file = stored.file(names, range());
    if (file === null) setUnsaved(`No data were saved: ${stored.fileOf} has no sample in this range.`);
    else saveFrom(file);
  }

  return { savePicture, saveData, unsaved };
}
