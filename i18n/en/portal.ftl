### Messages of the portal: the server's own pages. They are put into HTML as they are, so that they hold no <, & or double quotes.

dir = ltr
name = English
title = Models
search = Search
searchLabel = Search models
sort = Order
relevance = Best match
byTitle = Title
newest = Newest
largest = Largest
apply = Show
clear = Clear all
filters = Filters
results = Models found: { $count }
none = Nothing matches.
noneNext = Try fewer words or fewer filters, or see all models.
all = All models
page = Page { $page } of { $pages }
previous = Previous
next = Next
pages = Pages
country = Country
kind = Kind
period = Period
licence = Licence
size = Size
subject = Subject
size-under-1m = under 1 million triangles
size-1m-10m = 1 to 10 million
size-10m-100m = 10 to 100 million
size-over-100m = over 100 million
points = Points
triangles = Triangles
file = File
embargo = Public from { $day } on
restricted = Not public
feed = New models (feed)
packs = Packs
language = Language
failed = The list cannot be searched at the moment.
failedNext = The models themselves can still be opened at their addresses. Try again in a minute.
remove = remove
chosen = Chosen
version = Version { $number } of { $day }
signIn = Sign in
signOut = Sign out
userName = User name
password = Password
signInWrong = The user name or password is wrong.
signInWait = There were too many attempts. Try again in { $seconds ->
        [one] { $seconds } second
       *[other] { $seconds } seconds
    }.
signedIn = You are signed in as { $name }.
goOn = Continue
bytes = { $count ->
        [one] { $count } byte
       *[other] { $count } bytes
    }
kB = kB
MB = MB
GB = GB
extent = Extent
spacing = Finest spacing
reference = Reference system
local = local
notStated = not stated
broken = This file cannot be shown.
withdrawn = Withdrawn.
download = Download pack
empty = There is no model here yet.
emptyNext = Make a pack with kilwa build, put it into this folder, and reload this page.
map = Map
mapCount = Models on the map: { $count }
mapNone = None of these models has a public location.
mapSource = Outline of the land: Natural Earth, coarse.
mapWhole = The whole map
mapCloser = Models here: { $count }. Zoom in
mapMore = The first { $count } are listed; zoom in to see the others.
places = Places
list = List
collections = Collections
members = Models: { $count }
collectionFeed = This collection as a feed
noCollections = There are no collections yet.
extractTitle = Downloads
extractLead = The mesh for other programs, without cracks, in the size that you need. It is made on request.
extractFormat = Format
extractSize = Size
extractWhole = Whole
extractTriangles = Maximum number of triangles
extractError = Maximum distance from the surface, in metres
extractMake = Make the file
extractBack = Back to the model
extractQueued = Your file is waiting in the queue. Files ahead of it: { $count }.
extractRunning = Your file is being made: { $percent } %.
extractWait = This page refreshes by itself. You can close it and come back to its address.
extractReady = The file is ready. The download begins by itself.
extractFailed = The file could not be made.
extractFull = The server’s disk is full. Its administrator has to free space; try again later.
extractFetched = Fetched from the archive’s storage so far: { $size }.
extractHalted = The archive’s storage does not answer at the moment. Work on your file continues when it does; this page refreshes by itself.
extractAway = The archive’s storage does not answer, or does not deliver the model at the moment. Try again in a minute.
extractBusy = Too many files are being made at the moment. Try again in { $seconds ->
        [one] { $seconds } second
       *[other] { $seconds } seconds
    }.
extractTooLarge = The file would have about { $size }, but this server keeps files of up to { $most }. Choose fewer triangles, or download the pack.
extractWrong = This is not a valid size. Enter a whole number of triangles, at least 1, or a distance in metres such as 0.01.
extractUnknown = Nothing is being made at this address. Request the file again.
extractPack = As it was published
preview = Preview
plyWhat = colours and all attributes; for programs for point clouds and meshes
glbWhat = colours; for the web, Blender, presentations
objWhat = text, colours; opens almost everywhere
stlWhat = shape only; for 3D printing
parts = This archive
signOutEverywhere = Sign out everywhere
signInFailed = The server cannot sign anybody in at the moment. Try again in a minute.
tooLong = This address is too long.
tooLongNext = Choose fewer filters, or search with fewer words.
tooMany = At most { $count } values of one filter can be chosen at once: { $filter }.
tooManyNext = Use only the first { $count }
extractTime = Estimated time left: { $from } to { $to } min.
extractTimeShort = Estimated time left: less than 1 min.
extractTimeUnknown = The time left cannot be estimated yet.
extractShare = Your network already has { $count ->
        [one] { $count } file
       *[other] { $count } files
    } in the queue, the limit for one network. Try again in { $seconds ->
        [one] { $seconds } second
       *[other] { $seconds } seconds
    }.
extractTooMany = Your network has asked for { $count ->
        [one] { $count } new file
       *[other] { $count } new files
    } in the last ten minutes, the limit for one network. Try again in { $seconds ->
        [one] { $seconds } second
       *[other] { $seconds } seconds
    }.
months = January February March April May June July August September October November December
dateDay = { $day } { $month } { $year }
dateMonth = { $month } { $year }
survey = Survey
surveyStations = { $count ->
        [one] { $count } station
       *[other] { $count } stations
    }
surveySamples = { $count ->
        [one] { $count } sample
       *[other] { $count } samples
    }
surveyEmpty = This survey has no stations yet. Import scans with kilwa scans import, and reload this page.
surveyPlan = Plan
surveyPlanWhat = The samples of all stations, seen from above: the more surface there is above a place, the more strongly it is drawn. The line at a station is the x axis of its scanner.
surveyPlanNone = No station has a known pose, so there is no plan.
surveyPoseUnknown = Pose unknown
surveyUnknownNext = These stations are not on the plan. Register them with kilwa register, or enter their poses in survey.toml.
surveySame = { $count ->
        [one] { $count } station has
       *[other] { $count } stations have
    } exactly the same pose as another. If these scans are not registered, their poses are not known yet: use kilwa register, or enter them in survey.toml.
surveyList = Stations
surveyStation = Station
surveySource = Source file
surveyNumber = Scan in this file
surveyScan = scan { $number }
surveyGrid = Grid
surveyGridNone = none (point cloud)
surveySamplesHead = Samples
surveyMasked = Masked
surveyPosition = Position
surveyHeading = Heading
surveyHeadingWhat = Heading: direction of the scanner’s x axis, clockwise from the y axis of the survey.
surveyPose = Pose
surveyFixed = fixed
surveyPlacement = Placed by
surveyAnchor = anchor
surveyByControl = control points
surveyBySurface = surface
surveyPoseChanged = pose changed since the registration
surveySigma = Standard deviation
surveySigmaWhat = Standard deviation: of a coordinate of the station, and of its rotation about the least certain axis, relative to the anchor or the fixed stations.
surveyLinks = Links connect stations that see the same surface. Colour and dashes show the residual; thin lines have few samples.
surveyReason = Reason:
surveyChain = Weakest chain:
surveyLinkList = Links
surveyResidual = Residual
surveyOverlap = Overlap
surveyContradicted = Contradicted
surveyLinkWhat = Largest residual first. Residual: root mean square distance between the two surfaces. Contradicted: share of the samples that rays of the other station pass through. Standard deviation: of the pose of one station relative to the other, from this link alone.
surveyRefused = Stations that could not be placed
surveyRemedy = What to do:
surveyCandidate = Candidate pose of an unplaced station
surveyCandidates = Candidate poses, best first
surveyCandidateOf = Candidate pose of { $name }, matched with { $other }
surveyMatched = Matched with
surveyAgreement = Agreement
surveyCandidateWhat = Overlap: share of the surface of both stations that the other one should see too. Agreement: share of this common surface that matches. Contradicted: share of it that rays of the other station pass through.
surveyRefusedPicture = Range image of station { $name }
surveyRegistrationBroken = registration.json cannot be read.
surveyInstrument = Instrument
surveyRange = Longest range
surveyBroken = This station cannot be read.
surveyControl = Control point
surveyPhotograph = Photograph
surveyAll = Plan and all stations
surveyWrong = survey.toml has mistakes
surveyWrongNext = Correct them and reload this page.
surveyLost = There is nothing at this address
surveyLostNext = The survey has no station of this name. It may have been renamed or removed.
controlTitle = Control points
controlMark = Mark control points
controlWhat = If two stations share too little surface, or fit together in more than one pose, mark at least three places that both see. They can then be registered from these points.
controlA = First station
controlB = Second station
controlNone = Choose a station
controlChoose = Show these stations
controlSame = Choose two different stations.
controlKinds = Pictures of both stations
controlScripts = Marking points needs JavaScript, which is turned off in this browser.
controlHelp = Click the same place in both pictures, for example the corner of a window or of a stone. Zoom in first: the closer you are, the more precisely you can mark. Choose places that are far apart and at different heights.
controlKeys = With the keyboard: go to a picture with Tab, zoom with + and −, move the picture with the arrow keys and the cross with Shift and the arrow keys; Enter marks the place under the cross. Escape discards a place marked in only one picture, Ctrl+Z undoes the last step.
controlFirst = Mark a place in one picture, then the same place in the other.
controlOther = Mark the same place in { $name }.
controlNeed = { $count ->
        [one] { $count } more pair is needed.
       *[other] { $count } more pairs are needed.
    }
controlLine = The points lie on a straight line. Add one away from it.
controlPair = Pair { $number }
controlCheck = { $point } does not fit: its residual is { $length }. Check it.
controlCheckThree = The three pairs do not fit each other (residual up to { $length }): check them, or add a fourth.
controlSuspect = check
controlFits = The pairs fit each other; the largest residual is { $length }. More pairs make the pose more reliable.
controlReading = Reading the sample…
controlEmpty = There is no sample at this place: the scanner measured nothing there, or a mask hides it. Mark another place.
controlUnreachable = The server is not responding. Check the connection and reload this page.
controlFailed = The server reports: { $reason }
controlMany = No more than { $count } pairs can be marked.
controlUndo = Undo
controlPairs = Pairs
controlName = Name
controlIn = In { $name } (m)
controlRemove = Remove
controlRemoveName = Remove { $name }
controlKnown = in survey.toml
controlEntries = Entries for survey.toml
controlNext = Add this text to the end of survey.toml, then run kilwa register on the folder of the survey.
controlNextAgain = Add this text to the end of survey.toml, then run kilwa register with --again on the folder of the survey: otherwise both stations keep their current poses.
controlNextFixed = Both stations have fixed = true in survey.toml, so registration does not change their poses. Remove it from the station that may move, add this text to the end of survey.toml, then run kilwa register with --again on the folder of the survey.
controlCopy = Copy
controlCopied = Copied.
controlCopyByHand = The text is selected: copy it with Ctrl+C.
controlDownload = Download
north = N
zoom = Zoom
zoomIn = Zoom in
zoomOut = Zoom out
zoomWhole = Show all
zoomHelp = Zoom with the wheel, two fingers, or the keys + and −; 0 shows all. Drag or use the arrow keys to move.
showWhat = Pictures of this station
showRange = Range
showIntensity = Intensity
showColour = Colour
showMask = Masks
altRange = Range image of station { $name }, as its scanner saw its surroundings: from dark, { $near } away, to bright, { $far }.
altIntensity = Intensity image of station { $name }, as its scanner saw its surroundings: from dark, { $low }, to bright, { $high }.
altColour = Colour image of station { $name }, as its scanner saw its surroundings.
altMask = Image of station { $name } in grey, with masked samples in the colours of their masks.
maskOff = off
maskOutdated = made with other poses
noReturn = No return
noData = No data
featured = Featured models
imprint = Legal notice
contact = Contact
lostNext = The model may have been renamed or removed.
